"""The report of an evaluation: tables, curves and pictures in one HTML file."""

"""Shipped models, one folder each (package data of the distribution)."""

"""The viewer, without a word of Qt: what is shown, what is asked for, and what is done."""

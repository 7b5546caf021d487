"""A person at a terminal: typed lines, questions, and the words for numbers."""

"""A person at a terminal: lines that are typed, questions, words in common."""

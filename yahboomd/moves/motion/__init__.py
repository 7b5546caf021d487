"""The pure part of the moves: speed profiles, courses, plans, and the control along them."""

"""The people of a fleet at one robot: keys under their names, and who did what."""

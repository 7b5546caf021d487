"""The 4-channel motor driver with either firmware: the vendor's, and the article's."""

"""``probe``: names the board, explains what is wrong, and stores its settings."""

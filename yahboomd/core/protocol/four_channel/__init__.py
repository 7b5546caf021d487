"""The 4-channel motor driver: `$name:args#` frames, its two dialects, and what it stores."""

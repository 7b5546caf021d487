"""The command ``yahboomd web``: serves the page, shows its link, makes tokens and a certificate."""

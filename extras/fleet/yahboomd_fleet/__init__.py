"""Many robots: their certificates, the access rules of their routers, and a stop for all."""

"""What people look at: the player and the figures."""

"""What launch files share: the robot as yahboomd configures it, parameters, arguments."""

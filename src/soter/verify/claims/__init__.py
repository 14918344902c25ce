"""What is proved of a module, group by group and of their product."""

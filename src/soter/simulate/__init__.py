"""Virtual-time runs on either engine."""

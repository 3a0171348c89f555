"""What a user touches: command line, pytest plugin, report pages."""

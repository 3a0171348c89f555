"""One module per subcommand: `command` is its parser, what it does stands apart and loads late."""

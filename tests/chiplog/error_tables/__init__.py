"""Every kind of message a user can meet, one module per subject."""

"""What the generated pages of the reference are made of: one module a page or two."""

"""The cases and drives in this folder serve the tests of the folders in it too."""

"""Reading and writing cameras: one file per format."""

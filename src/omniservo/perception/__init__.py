"""Images to dots; dots tracked and matched between views."""

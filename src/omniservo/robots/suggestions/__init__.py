"""A suggested camera mount, start configuration and table for an arm of which only its file is known."""

"""Plans that an uncertain estimate may be trusted with, at a stated risk."""

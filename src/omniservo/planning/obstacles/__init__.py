"""What the path must not hit and the sight must not meet: the kinds of obstacle, and their files."""

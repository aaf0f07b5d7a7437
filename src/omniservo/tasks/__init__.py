"""Task files: everything a run needs, validated."""

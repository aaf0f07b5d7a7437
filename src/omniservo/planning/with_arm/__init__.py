"""Planning for the whole arm: its joints and its bodies take part in the search."""

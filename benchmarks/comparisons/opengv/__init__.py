"""OpenGV beside ours: relative and absolute pose on bearings, past 90° from the axis as well."""

"""The planning benchmark: ours beside what people use today, on published random problems."""

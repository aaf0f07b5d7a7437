"""One file per calibration format, and the text that formats are made of."""

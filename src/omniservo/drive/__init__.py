"""The drive process: it alone commands the arm, at 200 Hz, with every twist's deadline kept."""

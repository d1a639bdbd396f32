"""The shapes of covers: one file a shape, with all that the program knows of it but its surface."""

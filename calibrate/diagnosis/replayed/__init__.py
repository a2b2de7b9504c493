"""What a replay says of the models of a diagnosis: level of the stiffness, bands, and the rule of the verdict."""

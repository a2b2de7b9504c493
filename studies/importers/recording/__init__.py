"""From a recorded test to an Experiment: `Recording` of an importer, its `Series`, clocks, missing frames, noise."""

"""mrcal beside ours: projection of the models that both have, calibration and its stated uncertainty."""

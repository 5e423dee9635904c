"""What the estimator is given: device, settings and effects as declared, samples as recorded, the drive that acted."""

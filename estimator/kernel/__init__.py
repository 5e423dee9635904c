"""The compiled kernels: flow, observer, controller, angle.  Scaled units throughout (`estimator.scaling`)."""

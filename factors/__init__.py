"""What one measurement says about the states: residuals, Jacobians, weights. numpy and gtsam only.

A node is a time with an attitude `R_nb`, a velocity `v_n`, a position `p_n` and the phase of the
odometer's pulse counter; its error state is `[theta (3), v (3), p (3), phase (1)]` with
`R_nb <- R_nb Exp(theta)` and everything else additive. Calibrations (biases, scale, mounting ...)
form a chain of vectors on a coarser time grid, laid out by `factors.calibration.Layout`.
Every factor is a function of arrays over all its occurrences and returns one `factors.block.Block`.
"""

"""Gaussian state estimation: prediction, conditioning and smoothing of N(mean, covariance).

References
----------
S. Särkkä, "Bayesian Filtering and Smoothing", Cambridge University Press, 2013.
"""

import numpy as np
import scipy

from workbench.utils.arrays import FloatArray

_RIDGE = 1e-12
"""Added to the diagonal of a block's covariance before it is inverted, in squared units of the state."""
_RCOND = 1e-12
"""Relative singular value below which a predicted covariance counts as singular."""


def predict(
    mean: FloatArray, covariance: FloatArray, transition: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Predict the state of a linear model x' = F x + q, q ~ N(0, Q): m⁻ = F m, P⁻ = F P Fᵀ + Q (section 4.3).

    Parameters
    ----------
    mean : (D,) or (D, k)
        m, of one state or of k states with the same covariance.
    covariance : (D, D)
        P.
    transition : (D', D)
        F.
    noise : (D', D')
        Q.

    Returns
    -------
    m⁻ (D',) or (D', k), and P⁻ (D', D').
    """
    return transition @ mean, predict_covariance(covariance, transition, noise)


def predict_covariance(covariance: FloatArray, transition: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the predicted covariance F P Fᵀ + Q (D', D'); of an extended filter F is the Jacobian (section 5.2)."""
    return transition @ covariance @ transition.T + noise


def condition(
    mean: FloatArray, covariance: FloatArray, cross: FloatArray, innovation: FloatArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Condition a state on an observation y that is jointly Gaussian with it: m + C S⁻¹ v, P − C S⁻¹ Cᵀ.

    For y = H x + r, r ~ N(0, R), these are the Kalman filter's equations (section 4.3) with C = P Hᵀ, S = H P Hᵀ + R
    and v = y − H m. In general they are those of appendix A.1.

    Parameters
    ----------
    mean : (D,) or (D, k)
        m, of one state or of k states with the same covariance.
    covariance : (D, D)
        P.
    cross : (D, K)
        C, the covariance of the state and the observation.
    innovation : (K, K)
        S, the covariance of the observation; positive definite.
    residual : (K,) or (K, k)
        v, the observation less its expectation.

    Returns
    -------
    The conditional mean (D,) or (D, k), and covariance (D, D).

    Raises
    ------
    LinAlgError
        S is not positive definite.
    """
    factor = scipy.linalg.cho_factor(innovation, lower=True)
    updated = covariance - cross @ scipy.linalg.cho_solve(factor, cross.T)
    return mean + cross @ scipy.linalg.cho_solve(factor, residual), 0.5 * (updated + updated.T)


def condition_block(
    mean: FloatArray, covariance: FloatArray, block_mean: FloatArray, block_covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Replace the marginal of a state's first n columns; the other columns follow by their regression on these.

    The conditional distribution of the state given the block stays as it is (Jeffrey's rule); see `_replace`.

    Parameters
    ----------
    mean, covariance : (D,), (D, D)
        Of the state.
    block_mean, block_covariance : (n,), (n, n)
        The new marginal of the first n columns.

    Returns
    -------
    Mean (D,) and covariance (D, D) of the state.
    """
    n = len(block_mean)
    gain = np.asarray(np.linalg.solve(covariance[:n, :n] + _RIDGE * np.eye(n), covariance[:n]).T, np.float64)
    return _replace(mean, covariance, gain, block_mean - mean[:n], block_covariance - covariance[:n, :n])


def smooth(
    filtered: tuple[FloatArray, FloatArray], transition: FloatArray, predicted: tuple[FloatArray, FloatArray],
    smoothed: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the smoothed state of a step by the Rauch–Tung–Striebel smoother (section 8.2).

    m + G (mˢ − m⁻) and P + G (Pˢ − P⁻) Gᵀ with the gain G = P Fᵀ (P⁻)⁻¹, where a singular P⁻ is pseudo-inverted.

    Parameters
    ----------
    filtered : mean (D,), covariance (D, D)
        m and P of the step.
    transition : (D', D)
        F from the step to the next.
    predicted : mean (D',), covariance (D', D')
        m⁻ and P⁻ of the next step, before its observation.
    smoothed : mean (D',), covariance (D', D')
        mˢ and Pˢ of the next step.

    Returns
    -------
    The smoothed mean (D,) and covariance (D, D) of the step.
    """
    mean, covariance = filtered
    gain = np.asarray(np.linalg.lstsq(predicted[1], transition @ covariance, rcond=_RCOND)[0].T, np.float64)
    return _replace(mean, covariance, gain, smoothed[0] - predicted[0], smoothed[1] - predicted[1])


def _replace(
    mean: FloatArray, covariance: FloatArray, gain: FloatArray, shift: FloatArray, change: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance after the regressor's mean changes by `shift` and its covariance by `change`.

    m + G Δm and P + G ΔP Gᵀ: the law of total expectation and of total covariance.
    """
    updated = covariance + gain @ change @ gain.T
    return mean + gain @ shift, 0.5 * (updated + updated.T)

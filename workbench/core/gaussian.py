"""Gaussian state estimation: prediction and conditioning of N(mean, covariance).

References
----------
S. Särkkä, "Bayesian Filtering and Smoothing", Cambridge University Press, 2013.
"""

import scipy

from workbench.utils.arrays import FloatArray


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
    return transition @ mean, transition @ covariance @ transition.T + noise


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

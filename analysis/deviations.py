"""What differs between `paper=literal` and the papers, as data for the documentation."""

from typing import NamedTuple

from analysis import open_constants


class Deviation(NamedTuple):
    """One difference. paper: A to D. place: equation, section or figure. difference, reason: sentences."""

    paper: str
    place: str
    difference: str
    reason: str


_UNDEFINED = "The paper does not define it."
DEVIATIONS = tuple(
    Deviation(*entry)
    for entry in (
        # every paper
        ("A–D", "experiments", "Rendered persons, or simulated points, replace the footage.", "It is not available."),
        (
            "A–D", "experiments",
            "The assumed limb lengths are up to 3 %, girths 10 %, the camera 0.2 % and 0.1°, and the initial pose 3 cm "
            "and 0.05 rad wrong. `dataset.perturb=false` removes these errors.",
            "A real person's body and camera are never known exactly.",
        ),
        # A
        (
            "A", "section 3", "The root turns by Rz Ry Rx; shoulders abduct, flex and twist (Rx Ry Rz), "
            "hips flex, abduct and twist (Ry Rx Rz).", "With Rz innermost θz is the twist about the limb's own "
            "axis, as in fig. 4.",
        ),
        (
            "A", "section 5", "Limbs that continue each other do not occlude each other: thigh and calf, "
            "upper arm and forearm, forearm and hand, torso and thigh, torso and head.",
            "At their joint one always covers the other in part: the nearer arm and leg of a walk would be hidden.",
        ),
        (
            "A", "section 5", "All particles and limbs share the n sampled points. They are drawn on the patch, "
            "uniformly in its coordinates, not among its pixels.",
            "Likelihoods then differ by the poses and not by sampling noise.",
        ),
        ("A", "section 5", "Points outside an image are excluded and reduce q; α of a sphere is 0.", _UNDEFINED),
        (
            "A", "section 6.1", "States are sampled from the normal distribution truncated to the limits, and weighted "
            "by its probability within them.", "A filter can only sample from a normalised density; the product is the "
            "paper's.",
        ),
        (
            "A", "fig. 4", "The arm swings by 0.35 rad every 1.2 s and is seen obliquely; its elbow bends by 0.5 rad "
            "from frame 21 to frame 39.", "The paper: it bends slightly around frame 20.",
        ),
        (
            "A", "figs. 6 and 7", "The walker on a circle and the training cycles are generated, by one generator with "
            "different walkers. d is 7 there and 12 of CMU's walkers in fig. 5, where the paper's dancers have 5.",
            "No recorded walk on a circle is available.",
        ),
        (
            "A", "section 6.2", "Cycles are walks of CMU's walkers, divided at gait events instead of by hand. The gap "
            "between the ends of a cycle is distributed linearly over it.", "The dancers' motions are not available.",
        ),
        (
            "A", "section 6.2", "The torso's velocities are not part of the state.",
            "Neither eq. 14–17 nor the likelihood depends on them: without them the posterior of all other variables "
            "is the same.",
        ),
        (
            "A", "eq. 14", "λ is the standard deviation of a coefficient over the cycles, the singular value divided "
            "by √(m − 1).", "The unknown factor ε absorbs the quotient.",
        ),
        (
            "A", "eq. 15", "The phase advances by the mean speed of the training cycles; the equation has no drift.",
            "Without a drift the phase moves by noise only, whose deviation would be as large as a frame's advance.",
        ),
        # B
        (
            "B", "eq. 1", "Signal and noise of a period are the mean squares of an F ratio.",
            "The paper refers to a technical report; the ratio of its white noise is flat, as that of an F ratio.",
        ),
        (
            "B", "section 2.1", "Periods need not be whole, and must fit twice into a sequence.",
            "CMU's walks are short; longer periods have too few degrees of freedom.",
        ),
        (
            "B", "section 2.1", "For the alignment, angles are divided by their standard deviations and phases "
            "rounded to 1/256 of a cycle. The first sequence alone is a second initial reference.",
            "Sequences in opposite phase cancel in the paper's initial reference.",
        ),
        (
            "B", "section 2.2", "Slices are cubic splines; an unobserved point starts as the mean of the others.",
            _UNDEFINED,
        ),
        (
            "B", "section 2.2", "The Fourier functions are real and orthonormal, the mean is projected on them too, "
            "and the tolerance 1e-6 is relative.", "The mean of real cycles is not periodic; a relative tolerance is "
            "independent of units.",
        ),
        ("B", "fig. 1", "The axis of the signal-to-noise ratio is logarithmic.", "Angles differ by powers of ten."),
        (
            "B", "section 3", "The noise of the root's position is a walker's displacement per frame.",
            "The paper gives no value; nothing else moves the root.",
        ),
        ("B", "eq. 5", "Sampled points as for A, section 5.", "As for A."),
        # C
        (
            "C", "section 4", "The database is CMU's and Bandai's without the tracked performer, with 82 000 windows "
            "at 30 Hz instead of 50 000.", "The paper's recordings are not available.",
        ),
        (
            "C", "section 4", "Position and heading enter as velocities in the body's heading frame, and are predicted "
            "by increments.", "Otherwise a match depends on where and in which direction a person walks.",
        ),
        (
            "C", "section 4", "Velocities are per frame, by backward differences. 16 components explain 94 % of the "
            "variance (the paper: 89 %); with velocities per second 77 %.", "The unit is not stated; A uses m/frame.",
        ),
        (
            "C", "section 4.2", "In a leaf, a window's probability given the probe is raised to 1/β.",
            "The paper has no β there: at the low temperatures of tracking and synthesis a leaf would be more varied "
            "than the tree.",
        ),
        ("C", "section 4", "Samples are not re-weighted (footnote 3); `importance_correction` does.",
         "The paper does not state that it does."),
        (
            "C", "section 3", "The likelihood is A's motion on truncated cones, for the arm as a ratio of foreground "
            "to a static background, with points inside the limbs; without edges and ridges, and with A's differences.",
            "C refers to two papers, most likely A and Sidenbladh & Black 2001, whose cues are such ratios.",
        ),
        # D
        (
            "D", "eq. 2", "All ellipsoids share one width of their field, and lie in rows along the limbs.",
            "The paper gives neither the widths nor the ellipsoids.",
        ),
        (
            "D", "eq. 5", "A point belongs to the part with the smallest abs(log f/C) instead of abs(f − C).",
            "One centimetre inside a forearm abs(f − C) exceeds C, the value of every distant limb.",
        ),
        (
            "D", "eq. 10", "The global motion is fitted by distances, from the extrapolation of the two previous "
            "frames.", "The field vanishes beyond a fraction of a limb's radius.",
        ),
        (
            "D", "eq. 14", "The derivative by μ includes that of the mean and is exact, of a periodic spline.",
            "The equation omits a term of eq. 9; finite differences approximate the same derivative.",
        ),
        (
            "D", "section 3.2", "Training motions are CMU's and Bandai's walks and runs without the performer's data "
            "set: few speeds, and nearly all runs are of one data set, whose three actors count as one person. The "
            "body has 25 parameters instead of about 80.",
            "The recordings of four people on a treadmill, at nine speeds of walking and seven of running, are not "
            "available.",
        ),
        (
            "D", "section 3.2", "There are 5 coefficients, which explain 81 % of the walking database; 0.9 need 10.",
            "The paper states both numbers. On validation people the walk in one style is nearer with 10 (knees 6.4° "
            "instead of 7.8°), that with a style per frame with 5 (6.8° instead of 9.0°).",
        ),
        ("D", "section 4", "The initial pose and the phases of the ends are the true ones with an error.",
         "The paper sets them by hand."),
        (
            "D", "fig. 10", "The arms are fitted like the legs.",
            "The paper does not track them, and does not say what becomes of their points.",
        ),
        (
            "D", "fig. 10", "Seven of the 14 frames are of each motion; the transition is centred.",
            "The paper has four frames of walking and three of the transition; here both motions have equally many. On "
            "seeds 100 to 102 the knees err by 26° with the transition in the middle, by 28° around the fifth frame.",
        ),
        ("D", "fig. 6", "Angles are compared with the truth instead of gyroscopes.", "Rendered persons have none."),
    )
)  # fmt: skip
"""All differences of the literal rows from the papers, and their unspecified parts."""


def page() -> str:
    """Return the page of the documentation, in Markdown."""
    lines = [
        "# Deviations from the papers", "",
        "This page is for readers who compare a result of `paper=literal` with its publication. It lists every "
        "difference that remains, and the constants that the papers leave open. *Ours* has further differences, which "
        "the file of each experiment lists under `paper.literal`.", "",
        "| paper | place | difference | reason |", "| --- | --- | --- | --- |",
        *(f"| {each.paper} | {each.place} | {each.difference} | {each.reason} |" for each in DEVIATIONS), "",
        *open_constants.section(),
    ]  # fmt: skip
    return "\n".join(lines)

"""The seams of the workbench: what the parts of a run hand to each other.

Glossary, the field's words as they are used here:

ancestor        the particle of the frame before that a particle was drawn from
annealing       weighting by powers of the likelihood that rise to one, as an optimiser; tempering is its exact kin
arrowhead       a matrix that is banded but for a dense border: the normal equations of all frames with shared unknowns
bootstrap       the filter, or its move, that proposes from the prior and weights by the likelihood
clip            the frames of one run, decoded once
coefficients    coordinates of a learned motion model, in standard deviations
density         p(state_t | state_t-1) where it can be evaluated, not just drawn from
discrepancy     what a learned motion misses of a person it was not learned from, and how that goes on in time
evidence        log p(frames so far), the filter's normalising constant
frame           one time step's observations: images or points, with its time in seconds
inference       turns frames, prior and likelihood into steps
likelihood      log p(frame_t | pose_t, pose_t-1, frame_t-1), up to a constant
look            a likelihood that has seen one frame and judges poses of it
memory          what an inference keeps after a frame to go on from it, beside what its likelihood remembers
move            how a particle filter takes its particles from one frame to the next
particle        one weighted state
pose            the body's 25 numbers: root position (m), root rotation (rad), 19 joint angles (rad)
powers          what a prior can do beside drawing, such as having a density
prior           the temporal prior p(state_t | state_t-1)
proposal        what a prior draws from where that is not itself; weights correct for it
residual        a whitened, dimensionless number whose square least squares adds up
shape           limb lengths and radii of one person, m
skeleton        joints, parents, axes, offsets and limits, as data
state           what a prior evolves, one row of a packed (N, D) array; its columns are named by a state space
step            one frame's result: particles, weights, ancestors, expected pose
traits          what a part offers the others and needs of them, compared before anything is built
truth           the true pose or joints, where a dataset has them
"""

"""How much less sure to be of the next person than the few people are alike that a model was learned from."""

LEAST_PEOPLE = 3
"""Of fewer the spread has no finite estimate; they count as so many."""


def widening(n_people: int) -> float:
    """Factor of deviations that were learned from n people, about a mean that is known: √(n / (n − 2)).

    The deviation is an estimate, too: of normal people, the next is then Student's with n degrees of freedom (Gelman et
    al., *Bayesian Data Analysis*, 3rd ed. 2013, section 3.2), of which this is the deviation. 1.18 for seven people.
    """
    n = max(n_people, LEAST_PEOPLE)
    return float((n / (n - 2)) ** 0.5)

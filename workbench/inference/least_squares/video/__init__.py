"""What a fit to the detected joints of a video needs: the problem of all poses, hypotheses, contacts, flips, errors."""

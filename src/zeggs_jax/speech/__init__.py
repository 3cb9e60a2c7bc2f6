"""Sound: wave files in, log-mel features at the rate of the motion out."""

"""Bodies: BVH text, skeletons, poses, and the features the networks read."""

"""The stages of training, in order: codes, gestures, joint, prompts, video, denoiser; each is a `Stage` for one loop."""

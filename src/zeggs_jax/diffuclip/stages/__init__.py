"""The stages of training, in order: codes, gestures, joint, prompts, denoiser, video; one `Stage` each."""

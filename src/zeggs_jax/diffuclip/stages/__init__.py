"""The stages of training, in order: codes, gestures, joint, prompts, video, denoiser; one `Stage` each."""

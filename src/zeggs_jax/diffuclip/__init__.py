"""GestureDiffuCLIP (Ao et al. 2023): gestures from speech, its words, and a style prompt of words, motion or video."""

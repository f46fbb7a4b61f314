// Of each Gaussian: the sum of its gradients on the screen, how many are in it, and the dense step that saw it last.
struct Mark { norm_sum: f32, steps: u32, seen_by: u32 }

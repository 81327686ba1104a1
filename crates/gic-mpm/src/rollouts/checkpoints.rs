//! Checkpoints of a rollout, ever sparser as it goes on, within a memory budget.

use gic_simd::Scalar;

use crate::substep::state::State;

/// States at the starts of every `stride`-th segment.
pub(super) struct Checkpoints<R> {
    pub(super) stride: usize,
    /// Most states that fit the memory budget.
    most: usize,
    pub(super) states: Vec<State<R>>,
}

impl<R: Scalar> Checkpoints<R> {
    /// None yet; `most` is how many states may be held, those between two checkpoints included.
    pub(super) fn new(most: usize) -> Self {
        Self { stride: 1, most, states: Vec::new() }
    }

    /// States that the reverse pass holds at once: the checkpoints, and the starts of the segments between two of them.
    pub(super) fn held(&self) -> usize {
        self.states.len() + self.stride
    }

    /// Offers the state at the start of a segment; segments come in order, or start over at an earlier one.
    pub(super) fn offer(&mut self, segment: usize, state: &State<R>) {
        if !segment.is_multiple_of(self.stride) {
            return;
        }
        self.states.truncate(segment / self.stride);
        // Half of the budget is for the starts of segments between two checkpoints, needed in the reverse pass.
        if (self.states.len() + 1) + self.stride > self.most && self.states.len() > self.stride {
            let mut index = 0;
            self.states.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.stride *= 2;
            if !segment.is_multiple_of(self.stride) {
                return;
            }
        }
        self.states.push(state.clone());
    }
}

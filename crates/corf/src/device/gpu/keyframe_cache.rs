//! The keyframes of a device: as many in its memory as may be, the others in main memory until a step names them.
//!
//! A keyframe keeps no copy in main memory until it first leaves the device. The one that leaves is that which no batch has named for longest.
//! A step reads the same words wherever they have been, so results do not depend on the bound.

use super::pyramid::{Packed, Pyramid};
use crate::Result;
use corf_gpu::Context;
use std::sync::{
    Arc,
    atomic::{AtomicU64, Ordering},
};

/// Bytes brought in for one submission: while the device works on it, the next ones come.
const BROUGHT_AT_ONCE: u64 = 64 << 20;

/// Bytes of device memory that keyframes may take, and those they take.
pub(crate) struct Budget {
    most: u64,
    taken: AtomicU64,
}

/// Share of a [`Budget`], given back when it is dropped.
pub(super) struct Lease {
    budget: Arc<Budget>,
    bytes: u64,
}

impl Budget {
    pub fn new(most: u64) -> Arc<Self> {
        Arc::new(Self { most, taken: AtomicU64::new(0) })
    }

    /// A share, if there is one.
    pub(super) fn take(self: &Arc<Self>, bytes: u64) -> Option<Lease> {
        let fits = |taken: u64| taken.checked_add(bytes).filter(|sum| *sum <= self.most);
        let taken = self.taken.fetch_update(Ordering::AcqRel, Ordering::Acquire, fits);
        taken.is_ok().then(|| Lease { budget: self.clone(), bytes })
    }

    /// A share beyond the bound, if need be.
    fn take_regardless(self: &Arc<Self>, bytes: u64) -> Lease {
        self.taken.fetch_add(bytes, Ordering::AcqRel);
        Lease { budget: self.clone(), bytes }
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.budget.taken.fetch_sub(self.bytes, Ordering::AcqRel);
    }
}

/// Device memory of one keyframe.
struct Place {
    buffer: wgpu::Buffer,
    lease: Lease,
}

impl Place {
    fn new(context: &Context, lease: Lease) -> Result<Self> {
        Ok(Self { buffer: context.storage("keyframe", lease.bytes)?, lease })
    }
}

/// One keyframe: on the device, in main memory, or both.
pub(crate) struct StoredView {
    pyramid: Pyramid,
    /// Words of its targets.
    words: usize,
    /// Its copy in main memory.
    home: Option<Vec<u32>>,
    place: Option<Place>,
    /// Which of all placings this is; what is bound to an earlier one is out of date.
    placing: u64,
    /// The last batch that named it, and the last submission that needs it.
    batch: u64,
    submission: u64,
}

impl StoredView {
    /// Puts a keyframe on the device if there is room, on any thread; nothing leaves for it.
    pub fn new(packed: Packed, context: &Context, budget: &Arc<Budget>) -> Result<Self> {
        let Packed { pyramid, words } = packed;
        let place = budget.take(bytes(words.len())).map(|lease| Place::new(context, lease)).transpose()?;
        if let Some(place) = &place {
            context.fill(&place.buffer, 0, &words);
            context.check("uploading a keyframe")?;
        }
        let (count, home) = (words.len(), place.is_none().then_some(words));
        Ok(Self { pyramid, words: count, home, place, placing: 0, batch: 0, submission: 0 })
    }
}

fn bytes(words: usize) -> u64 {
    (4 * words as u64).next_multiple_of(16)
}

/// All keyframes of a device.
pub(crate) struct KeyframeCache {
    pub budget: Arc<Budget>,
    keyframes: Vec<StoredView>,
    placings: u64,
    batches: u64,
    submissions: u64,
    brought_bytes: u64,
}

impl KeyframeCache {
    /// No keyframes, of which those on the device may take so many bytes.
    pub fn new(most: u64) -> Self {
        Self { budget: Budget::new(most), keyframes: vec![], placings: 0, batches: 0, submissions: 0, brought_bytes: 0 }
    }

    /// Takes a keyframe in; returns its number.
    pub fn push(&mut self, mut keyframe: StoredView) -> usize {
        self.placings += 1;
        keyframe.placing = self.placings;
        self.keyframes.push(keyframe);
        self.keyframes.len() - 1
    }

    pub fn len(&self) -> usize {
        self.keyframes.len()
    }

    pub fn get(&self, view: usize) -> Option<&Pyramid> {
        self.keyframes.get(view).map(|k| &k.pyramid)
    }

    /// Bytes that keyframes take on the device.
    pub fn taken_bytes(&self) -> u64 {
        self.budget.taken.load(Ordering::Acquire)
    }

    /// Bytes that have come back from main memory.
    pub fn brought_bytes(&self) -> u64 {
        self.brought_bytes
    }

    /// Where a keyframe's words are on the device, and which placing that is; nothing unless [`Self::bring`] has just brought it.
    pub fn place(&self, view: usize) -> Option<(&wgpu::Buffer, u64)> {
        let keyframe = &self.keyframes[view];
        keyframe.place.as_ref().map(|place| (&place.buffer, keyframe.placing))
    }

    /// Announces the keyframes of a batch: none of them leaves while another can.
    pub fn announce(&mut self, views: impl Iterator<Item = usize>) {
        self.batches += 1;
        for view in views {
            self.keyframes[view].batch = self.batches;
        }
    }

    /// Brings the keyframes of the steps of one submission to the device; returns how many of the steps, from the first, can be taken then: at
    /// least one. What was submitted before has the words it needs, whoever gets their place.
    pub fn bring(&mut self, context: &Context, views: &[usize]) -> Result<usize> {
        self.submissions += 1;
        let mut brought = 0;
        for (k, &view) in views.iter().enumerate() {
            if self.keyframes[view].place.is_none() {
                let bytes = bytes(self.keyframes[view].words);
                if k > 0 && brought + bytes > BROUGHT_AT_ONCE {
                    return Ok(k);
                }
                let Some(place) = self.make_room(context, bytes, k == 0)? else { return Ok(k) };
                let keyframe = &mut self.keyframes[view];
                if let Some(home) = &keyframe.home {
                    context.fill(&place.buffer, 0, home);
                }
                self.placings += 1;
                (keyframe.place, keyframe.placing) = (Some(place), self.placings);
                brought += bytes;
                self.brought_bytes += bytes;
            }
            self.keyframes[view].submission = self.submissions;
        }
        Ok(views.len())
    }

    /// Memory for a keyframe: what is free, or that of others that the present submission does not need. `regardless` of the bound, if there
    /// is no other way.
    fn make_room(&mut self, context: &Context, bytes: u64, regardless: bool) -> Result<Option<Place>> {
        loop {
            if let Some(lease) = self.budget.take(bytes) {
                return Place::new(context, lease).map(Some);
            }
            let free = |k: &StoredView| k.place.is_some() && k.submission != self.submissions;
            let leaving =
                (0..self.keyframes.len()).filter(|i| free(&self.keyframes[*i])).min_by_key(|i| self.keyframes[*i].batch);
            match leaving {
                Some(view) => {
                    let place = self.send_home(context, view)?;
                    if let Some(place) = place.filter(|p| p.lease.bytes == bytes) {
                        return Ok(Some(place));
                    }
                }
                None if regardless => return Place::new(context, self.budget.take_regardless(bytes)).map(Some),
                None => return Ok(None),
            }
        }
    }

    /// Takes a keyframe off the device; the first time it is read back.
    fn send_home(&mut self, context: &Context, view: usize) -> Result<Option<Place>> {
        let keyframe = &mut self.keyframes[view];
        if let (None, Some(place)) = (&keyframe.home, &keyframe.place) {
            let read = context.read::<u32>("keeping a keyframe in main memory", &[(&place.buffer, keyframe.words)])?;
            keyframe.home = read.into_iter().next();
        }
        Ok(keyframe.place.take())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_kept_and_given_back() {
        let budget = Budget::new(100);
        let first = budget.take(60).expect("there is room");
        assert!(budget.take(41).is_none());
        let second = budget.take(40).expect("to the last byte");
        let third = budget.take_regardless(10);
        assert!(budget.take(1).is_none());
        drop((first, second));
        assert!(budget.take(91).is_none() && budget.take(90).is_some());
        drop(third);
        assert_eq!(budget.taken.load(Ordering::Acquire), 0);
    }
}

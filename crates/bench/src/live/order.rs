//! Order of keyframes by their numbers.

use std::collections::BTreeSet;

/// Numbers that have been taken.
#[derive(Default)]
pub(super) struct Order {
    taken: BTreeSet<u64>,
}

impl Order {
    /// Says why a number cannot be taken now; none where it can.
    pub fn fault(&self, number: u64) -> Option<String> {
        let last = *self.taken.last()?;
        if number > last {
            None
        } else if self.taken.contains(&number) {
            Some(format!("keyframe {number} has been taken already: a duplicate"))
        } else {
            Some(format!("it comes after keyframe {last}: out of order"))
        }
    }

    /// Takes a number.
    pub fn take(&mut self, number: u64) {
        self.taken.insert(number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_rise_and_come_once() {
        let mut order = Order::default();
        assert_eq!(order.fault(4), None);
        order.take(4);
        order.take(9);
        assert_eq!(order.fault(10), None);
        assert!(order.fault(4).is_some_and(|f| f.contains("duplicate")));
        assert!(order.fault(5).is_some_and(|f| f.contains("after keyframe 9")));
        assert!(order.fault(0).is_some());
    }
}

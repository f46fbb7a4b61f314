//! Distances to the nearest points of a set, by a k-d tree.

use rayon::prelude::*;

/// Points of a leaf, at most.
const LEAF: usize = 8;

/// A balanced k-d tree over points: a node's children are the halves of its range on either side of the median along its longest side.
struct Tree {
    points: Vec<[f32; 3]>,
    /// Smallest and largest corner of each node's points, in the order in which nodes are built.
    boxes: Vec<[[f32; 3]; 2]>,
}

fn bounds(points: &[[f32; 3]]) -> [[f32; 3]; 2] {
    points.iter().fold([[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]], |[low, high], p| {
        [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
    })
}

impl Tree {
    fn new(mut points: Vec<[f32; 3]>) -> Self {
        let mut boxes = Vec::new();
        split(&mut points, 0, &mut boxes);
        Self { points, boxes }
    }

    /// Puts the squared distances from `p` to the nearest points, itself among them, into `best`, ascending.
    fn visit(&self, node: usize, range: std::ops::Range<usize>, p: &[f32; 3], best: &mut [f32]) {
        let [low, high] = self.boxes[node];
        let outside: f32 = (0..3).map(|k| (low[k] - p[k]).max(p[k] - high[k]).max(0.0).powi(2)).sum();
        if outside > best[best.len() - 1] {
            return;
        }
        if range.len() <= LEAF {
            for q in &self.points[range] {
                let squared: f32 = (0..3).map(|k| (p[k] - q[k]).powi(2)).sum();
                let place = best.partition_point(|b| *b <= squared);
                if place < best.len() {
                    best[place..].rotate_right(1);
                    best[place] = squared;
                }
            }
            return;
        }
        let middle = range.start + range.len() / 2;
        let [left, right] = [2 * node + 1, 2 * node + 2];
        let towards =
            |node: usize| (0..3).map(|k| (p[k] - 0.5 * (self.boxes[node][0][k] + self.boxes[node][1][k])).powi(2)).sum::<f32>();
        let halves = [(left, range.start..middle), (right, middle..range.end)];
        let [near, far] = if towards(left) <= towards(right) {
            halves
        } else {
            let [a, b] = halves;
            [b, a]
        };
        self.visit(near.0, near.1, p, best);
        self.visit(far.0, far.1, p, best);
    }
}

/// Orders the points of a node and those below it.
fn split(points: &mut [[f32; 3]], node: usize, boxes: &mut Vec<[[f32; 3]; 2]>) {
    if boxes.len() <= node {
        boxes.resize(node + 1, [[0.0; 3]; 2]);
    }
    let [low, high] = bounds(points);
    boxes[node] = [low, high];
    if points.len() <= LEAF {
        return;
    }
    let axis = (0..3).max_by(|a, b| (high[*a] - low[*a]).total_cmp(&(high[*b] - low[*b]))).unwrap_or(0);
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    let (left, right) = points.split_at_mut(middle);
    split(left, 2 * node + 1, boxes);
    split(right, 2 * node + 2, boxes);
}

/// Mean squared distance from each point to the three others nearest to it; points in one place count. There must be four at least.
pub fn mean_squared_distance_to_3(points: &[[f32; 3]]) -> Vec<f32> {
    let tree = Tree::new(points.to_vec());
    let of = |p: &[f32; 3]| {
        // The first is the point itself.
        let mut best = [f32::INFINITY; 4];
        tree.visit(0, 0..points.len(), p, &mut best);
        (best[1] + best[2] + best[3]) / 3.0
    };
    points.par_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn distances_are_those_that_comparing_all_with_all_finds() {
        let mut rng = Rng::keyed(1, 0, 0);
        for n in [4, 9, 100, 1777] {
            // A sheet, with some points in one place.
            let mut points: Vec<[f32; 3]> = (0..n).map(|_| [rng.uniform(), 3.0 * rng.uniform(), 0.01 * rng.uniform()]).collect();
            for i in 0..n / 10 {
                points[i] = points[n - 1];
            }
            let found = mean_squared_distance_to_3(&points);
            for (i, p) in points.iter().enumerate() {
                let mut all: Vec<f32> =
                    (0..n).filter(|j| *j != i).map(|j| (0..3).map(|k| (p[k] - points[j][k]).powi(2)).sum()).collect();
                all.sort_by(f32::total_cmp);
                assert_eq!(found[i], (all[0] + all[1] + all[2]) / 3.0, "{n} points, {i}");
            }
        }
    }
}

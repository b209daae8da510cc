//! Distribution of the moves of a speed: w(m, v) of section 10 of the guide, Route, for the speeds
//! v of its cell. The weights of each v sum to one.

/// Number of nodes: speeds, evenly spaced over the cell, that stand for a speed of the grid.
const NODES: usize = 8;
/// Probability that a vehicle at a speed of the grid drives it exactly. Many do, above all at the
/// speed at which the route was recorded.
const EXACT: f64 = 0.5;

/// Distribution of the number of places that a step moves on, at a speed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Window {
    /// Move of the first weight.
    pub(super) first: isize,
    pub(super) weights: Vec<f64>,
    /// Nodes of the cell; `by_node` has the weights of the moves of each, row by row.
    pub(super) nodes: Vec<f64>,
    by_node: Vec<f64>,
    /// Probability of each node.
    pub(super) shares: Vec<f64>,
    /// Width of the part of the cell that a node stands for.
    pub(super) spacing: f64,
}

impl Window {
    pub(super) fn new(values: &[f64], g: usize, slack: f64) -> Self {
        let half = |a: usize, b: usize| 0.5 * (values[b] - values[a]);
        let (mut low, mut high) = (values[g], values[g]);
        // Speed 0 has no cell; at the ends of the grid, cells are symmetric.
        if values[g] != 0.0 && values.len() > 1 {
            let last = values.len() - 1;
            low -= if g == 0 { half(0, 1) } else { half(g - 1, g) };
            high += if g == last { half(last - 1, last) } else { half(g, g + 1) };
        }
        // A cell without width (standing, or the only speed) is one node. Otherwise nodes are the
        // midpoints of eight equal parts, and the speed itself is a ninth.
        let count = if low == high { 1 } else { NODES };
        let spacing = (high - low) / count as f64;
        let mut nodes: Vec<f64> = (0..count).map(|q| low + spacing * (q as f64 + 0.5)).collect();
        let mut shares = vec![1.0 / count as f64; count];
        if count > 1 {
            shares.fill((1.0 - EXACT) / count as f64);
            nodes.push(values[g]);
            shares.push(EXACT);
        }
        let moves = values[g] != 0.0;
        let margin = isize::from(moves && slack > 0.0);
        // The speed itself may lie outside its nodes, which are inside the cell: if one neighbour
        // is near and the other far, nearly all of the cell lies on one side of the speed.
        let low = nodes.iter().copied().fold(f64::INFINITY, f64::min);
        let high = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let first = low.floor() as isize - margin;
        let last = high.ceil() as isize + margin;
        let width = (last - first + 1).unsigned_abs();
        // tri(m − v): a vehicle somewhere between two references, at speed v, passes m of them with
        // this probability. It sums to one over whole m, with the mean v.
        let triangle = |m: isize, v: f64| (1.0 - (m as f64 - v).abs()).max(0.0);
        let mut by_node = Vec::with_capacity(nodes.len() * width);
        for &v in &nodes {
            by_node.extend((first..=last).map(|m| {
                let beside = triangle(m - 1, v) + triangle(m + 1, v);
                let slack = if moves { slack } else { 0.0 };
                // w(m, v): the slack moves a part of the triangle to either side, which keeps its
                // mean.
                (1.0 - 2.0 * slack) * triangle(m, v) + slack * beside
            }));
        }
        let mut window = Self { first, weights: vec![0.0; width], nodes, by_node, shares, spacing };
        let mut weights = vec![0.0; width];
        window.weigh(|_| 1.0, &mut weights);
        window.weights = weights;
        window
    }

    pub(super) fn last(&self) -> isize {
        self.first + self.weights.len().cast_signed() - 1
    }

    /// Computes the weights of moves, given a likelihood of the speeds in the cell; returns the
    /// likelihood of the whole cell.
    pub(super) fn weigh(&self, likelihood: impl Fn(f64) -> f64, out: &mut [f64]) -> f64 {
        out.fill(0.0);
        let mut total = 0.0;
        let nodes = self.nodes.iter().zip(&self.shares);
        for ((&v, share), weights) in nodes.zip(self.by_node.chunks_exact(out.len())) {
            let p = share * likelihood(v);
            total += p;
            out.iter_mut().zip(weights).for_each(|(out, weight)| *out += p * weight);
        }
        total
    }
}

//! Points of a plane, sorted by squares of a grid: a row of squares is a run of the sorted points.

/// Largest number of squares in a row or column.
const MOST_SQUARES: f64 = 65_536.0;

/// Numbered points, found by their square.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    low: [f64; 2],
    side: f64,
    /// Largest square of each axis.
    last: [u64; 2],
    /// Row and column of each point's square, and its number; sorted.
    points: Vec<(u64, u32)>,
}

impl Grid {
    /// Sorts points into squares with at least this side. O(points log points).
    #[expect(clippy::cast_sign_loss, reason = "no point is below the lowest")]
    pub(super) fn new(points: &[[f64; 2]], side: f64) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        // At most 2^16 squares on an axis: row and column fit 32 bits each.
        let side = side.max(extent / MOST_SQUARES);
        let square = |axis: usize, x: f64| ((x - low[axis]) / side) as u64;
        let mut sorted: Vec<(u64, u32)> = (0..)
            .zip(points)
            .map(|(number, &[x, y])| (square(1, y) << 32 | square(0, x), number))
            .collect();
        sorted.sort_unstable();
        let last = [square(0, high[0]), square(1, high[1])];
        Self { low, side, last, points: sorted }
    }

    /// Passes on all points within a distance of a point, and some others nearby.
    #[expect(clippy::cast_sign_loss, reason = "squares are counted from the lowest, 0")]
    pub(super) fn near(&self, [x, y]: [f64; 2], distance: f64, mut take: impl FnMut(usize)) {
        let range = |axis: usize, x: f64| {
            let square = |x: f64| (x - self.low[axis]) / self.side;
            (square(x - distance).max(0.0), square(x + distance).min(self.last[axis] as f64))
        };
        let (columns, rows) = (range(0, x), range(1, y));
        // Empty if the distance does not reach the grid, or is NaN.
        if !(columns.0 < columns.1 + 1.0
            && rows.0 < rows.1 + 1.0
            && columns.1 >= 0.0
            && rows.1 >= 0.0)
        {
            return;
        }
        // Columns of a row are consecutive keys, so one search finds their run.
        for row in rows.0 as u64..=rows.1 as u64 {
            let (first, last) = (row << 32 | columns.0 as u64, row << 32 | columns.1 as u64);
            let start = self.points.partition_point(|point| point.0 < first);
            let points = self.points[start..].iter().take_while(|point| point.0 <= last);
            points.for_each(|point| take(point.1 as usize));
        }
    }
}

//! Strongly connected components of a graph, by Tarjan (1972).

/// Marks a vertex without a number.
const NONE: u32 = u32::MAX;

/// Number of the strongly connected component of each vertex. `next` gives the ends of the edges
/// out of a vertex. Not recursive, since a long road would overflow the stack. O(vertices +
/// edges).
pub fn components<I: Iterator<Item = usize>>(
    vertices: usize,
    next: impl Fn(usize) -> I,
) -> Vec<u32> {
    let (mut component, mut found) = (vec![NONE; vertices], 0);
    // `order` has for each vertex its number in the order of discovery, and `low_link` the lowest
    // such number in `stack` that it is known to reach.
    let (mut order, mut low_link, mut count) = (vec![NONE; vertices], vec![0; vertices], 0);
    // `stack` holds the vertices without a component, in the same order; `path` the depth-first
    // path to the current vertex, with the remaining ends of each. Every vertex in
    // `stack` reaches one in `path` that was met no later than itself, or it would have its
    // component.
    let (mut stack, mut path) = (Vec::new(), Vec::new());
    for root in 0..vertices {
        if order[root] != NONE {
            continue;
        }
        path.push((root, next(root)));
        while let Some((vertex, ends)) = path.last_mut() {
            let vertex = *vertex;
            if order[vertex] == NONE {
                (order[vertex], low_link[vertex]) = (count, count);
                count += 1;
                stack.push(vertex);
            }
            if let Some(to) = ends.next() {
                if order[to] == NONE {
                    path.push((to, next(to)));
                } else if component[to] == NONE {
                    // An edge into a finished component cannot lead back, and is skipped.
                    low_link[vertex] = low_link[vertex].min(order[to]);
                }
                continue;
            }
            path.pop();
            if let Some(&(before, _)) = path.last() {
                low_link[before] = low_link[before].min(low_link[vertex]);
            }
            // The vertex reaches nothing met earlier, so it is the root of a component: itself and
            // all that is above it in `stack`.
            if low_link[vertex] == order[vertex] {
                while let Some(member) = stack.pop() {
                    component[member] = found;
                    if member == vertex {
                        break;
                    }
                }
                found += 1;
            }
        }
    }
    component
}

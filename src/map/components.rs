//! Strongly connected components of a graph, by Tarjan (1972).

/// Marks a vertex without a number.
const NONE: u32 = u32::MAX;

/// Number of the strongly connected component of each vertex. `next` gives the ends of the edges
/// out of a vertex. There is no recursion, since a long road would overflow the stack. O(vertices +
/// edges).
pub fn components<I: Iterator<Item = usize>>(
    vertices: usize,
    next: impl Fn(usize) -> I,
) -> Vec<u32> {
    let (mut component, mut found) = (vec![NONE; vertices], 0);
    // For each vertex, the order in which it was met, and the lowest order of a vertex in `open`
    // that it is known to reach.
    let (mut met, mut lowest, mut count) = (vec![NONE; vertices], vec![0; vertices], 0);
    // `open` holds the vertices without a component in the order in which they were met; `path` the
    // depth-first path to the current vertex, with the ends that are left of each. Every vertex in
    // `open` reaches one in `path` that was met no later than itself, or it would have its
    // component.
    let (mut open, mut path) = (Vec::new(), Vec::new());
    for root in 0..vertices {
        if met[root] != NONE {
            continue;
        }
        path.push((root, next(root)));
        while let Some((vertex, ends)) = path.last_mut() {
            let vertex = *vertex;
            if met[vertex] == NONE {
                (met[vertex], lowest[vertex]) = (count, count);
                count += 1;
                open.push(vertex);
            }
            if let Some(to) = ends.next() {
                if met[to] == NONE {
                    path.push((to, next(to)));
                } else if component[to] == NONE {
                    // An edge into a finished component cannot lead back, and is skipped.
                    lowest[vertex] = lowest[vertex].min(met[to]);
                }
                continue;
            }
            path.pop();
            if let Some(&(before, _)) = path.last() {
                lowest[before] = lowest[before].min(lowest[vertex]);
            }
            // The vertex reaches nothing met earlier, so it is the root of a component: itself and
            // all that is above it in `open`.
            if lowest[vertex] == met[vertex] {
                while let Some(member) = open.pop() {
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

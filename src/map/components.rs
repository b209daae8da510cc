//! Strongly connected components of a graph.

/// Mark for no number.
const NONE: u32 = u32::MAX;

/// Number of the strongly connected component of each vertex, by Tarjan (1972), without recursion:
/// a long road takes no stack. `next` gives the ends of the edges out of a vertex. O(vertices +
/// edges).
pub fn components<I: Iterator<Item = usize>>(
    vertices: usize,
    next: impl Fn(usize) -> I,
) -> Vec<u32> {
    let (mut component, mut found) = (vec![NONE; vertices], 0);
    // Order in which vertices were met, and the first met one that is known to be reached.
    let (mut met, mut lowest, mut count) = (vec![NONE; vertices], vec![0; vertices], 0);
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
                    lowest[vertex] = lowest[vertex].min(met[to]);
                }
                continue;
            }
            path.pop();
            if let Some(&(before, _)) = path.last() {
                lowest[before] = lowest[before].min(lowest[vertex]);
            }
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

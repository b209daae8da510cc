//! Routes as GeoJSON.

use std::fmt::Write;

use super::{Matcher, Stretch};
use crate::line_string;

impl Matcher {
    /// Returns a route as GeoJSON text: a collection with one line per stretch, in order. The
    /// properties of a line are the ids of its nodes as `from` and `to`, `enter_m`, `exit_m` and
    /// `off_road`.
    #[must_use]
    pub fn route_to_geojson(&self, route: &[Stretch]) -> String {
        let mut text = String::from(r#"{"type":"FeatureCollection","features":["#);
        for (number, stretch) in route.iter().enumerate() {
            let Stretch { edge, enter, exit, .. } = *stretch;
            let separator = if number == 0 { "\n" } else { ",\n" };
            let nodes = edge.map_or(String::new(), |edge| {
                let edge = &self.network.edges()[edge];
                let [from, to] = [edge.from, edge.to].map(|node| self.network.nodes()[node].id);
                format!(r#""from":{from},"to":{to},"#)
            });
            let (line, off_road) = (line_string(self.line(stretch)), edge.is_none());
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                r#"{separator}{{"type":"Feature","properties":{{{nodes}"enter_m":{enter:.1},"exit_m":{exit:.1},"off_road":{off_road}}},"geometry":{line}}}"#
            );
        }
        text + "\n]}\n"
    }
}

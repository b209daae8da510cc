//! Networks and lines as GeoJSON.

use std::fmt::Write;

use crate::RoadNetwork;
use wayfix::map::Position;

/// GeoJSON geometry of the line through positions.
pub(crate) fn line_string(points: impl IntoIterator<Item = Position>) -> String {
    let pair = |point: Position| format!("[{},{}]", point.longitude, point.latitude);
    let pairs: Vec<String> = points.into_iter().map(pair).collect();
    format!(r#"{{"type":"LineString","coordinates":[{}]}}"#, pairs.join(","))
}

impl RoadNetwork {
    /// Returns the network as GeoJSON text: a collection with one line per edge, or per two
    /// directions that share a line, with its `class`, `oneway`, `length_m`, and, if known,
    /// `speed_kmh` and `junction`.
    ///
    /// [`from_geojson`](Self::from_geojson) reads back all edges with their lengths, split where
    /// others meet them. The text has no node ids and no forbidden turns, and nodes at the same
    /// place are read as one.
    ///
    /// ```
    /// use wayfix_roads::NetworkBuilder;
    /// use wayfix::map::{Position, RoadClass};
    ///
    /// let mut builder = NetworkBuilder::new();
    /// builder.node(1, Position { latitude: 0.0, longitude: 0.5 })?;
    /// builder.node(2, Position { latitude: 0.0, longitude: 0.75 })?;
    /// builder.both_ways(1, 2, RoadClass::Main)?;
    /// let text = builder.build()?.to_geojson();
    /// assert!(text.contains(r#""oneway":"no""#));
    /// assert!(text.contains(r#"{"type":"LineString","coordinates":[[0.5,0],[0.75,0]]}"#));
    /// # Ok::<(), wayfix_roads::NetworkError>(())
    /// ```
    #[must_use]
    pub fn to_geojson(&self) -> String {
        let mut text = String::from(r#"{"type":"FeatureCollection","features":["#);
        let mut separator = "\n";
        for (e, edge) in self.edges().iter().enumerate() {
            let back = self.reverse(e).filter(|&back| self.is_same_road(e, back));
            if back.is_some_and(|back| back < e) {
                continue;
            }
            let oneway = if back.is_some() { "no" } else { "yes" };
            text += separator;
            separator = ",\n";
            // Writing to a string cannot fail.
            let _ = write!(
                text,
                r#"{{"type":"Feature","properties":{{"class":"{}","oneway":"{oneway}","length_m":{}"#,
                edge.class, edge.metres
            );
            if let Some(speed) = edge.speed {
                let _ = write!(text, r#","speed_kmh":{}"#, speed * 3.6);
            }
            if edge.roundabout {
                text += r#","junction":"roundabout""#;
            }
            let line = line_string(self.shape(e).iter().copied());
            let _ = write!(text, r#"}},"geometry":{line}}}"#);
        }
        text + "\n]}\n"
    }

    /// True if two edges are the directions of one road, with the same line and the same numbers.
    fn is_same_road(&self, edge: usize, back: usize) -> bool {
        let [a, b] = [edge, back].map(|e| self.edges()[e]);
        (a.class, a.metres, a.speed, a.roundabout) == (b.class, b.metres, b.speed, b.roundabout)
            && self.shape(edge).iter().eq(self.shape(back).iter().rev())
    }
}

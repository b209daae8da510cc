//! Maps from two CSV files, of places and of roads.

use std::io::Read;
use std::path::Path;

use csv::StringRecord;

use super::builder::Builder;
use super::map::{Road, RoadMap};
use super::report::CleaningReport;
use crate::files::{Row, Text, each_row, excerpt, open};
use crate::map::{Coordinates, MapError, Place};

impl<P: Coordinates> RoadMap<P> {
    /// Reads a map from two CSV files with headers. The type of the map determines whether it is on
    /// Earth (`RoadMap`) or in a plane (`RoadMap<PlanePosition>`).
    ///
    /// Places: `id,latitude,longitude,name`, with positions in degrees, or in a plane `id,x,y,name`,
    /// in metres; the name may be empty. Roads: `from,to,class,length_m`, where from and to are ids
    /// of places and the class is main, arterial, collector or street. In a plane, a road with an
    /// empty length is as long as the straight line between its ends.
    ///
    /// # Errors
    ///
    /// [`MapError::Line`] with file and line for everything that [`RoadMap::new`] refuses, for a
    /// missing or wrong header, a wrong number of columns, or a value that can't be parsed;
    /// [`MapError::Read`] if a file can't be opened or read.
    pub fn from_csv_files(
        places: impl AsRef<Path>,
        roads: impl AsRef<Path>,
    ) -> Result<Self, MapError> {
        read_files(Builder::strict(), places.as_ref(), roads.as_ref()).map(|read| read.0)
    }

    /// Reads a map from two readers, as [`from_csv_files`](Self::from_csv_files) does from files;
    /// errors call them "places" and "roads".
    ///
    /// ```
    /// use wayfix::map::{PlanePosition, RoadMap};
    ///
    /// let places = "id,latitude,longitude,name\n1,-35.28,149.13,Civic\n2,-35.29,149.13,\n";
    /// let roads = "from,to,class,length_m\n1,2,main,1113\n2,3,main,1113\n";
    /// let city: Result<RoadMap, _> = RoadMap::from_csv(places.as_bytes(), roads.as_bytes());
    /// assert_eq!(
    ///     city.unwrap_err().to_string(),
    ///     "roads, line 3: the road from place 2 to place 3 needs place 3, which does not exist"
    /// );
    ///
    /// let places = "id,x,y,name\n1,0,0,dock\n2,30,40,shelf\n";
    /// let roads = "from,to,class,length_m\n1,2,main,70\n2,1,street,\n";
    /// let warehouse =
    ///     RoadMap::<PlanePosition>::from_csv(places.as_bytes(), roads.as_bytes())?;
    /// assert_eq!(warehouse.road_metres_from(0), [Some(0.0), Some(70.0)]);
    /// assert_eq!(warehouse.road_metres_from(1), [Some(50.0), Some(0.0)]);
    /// # Ok::<(), wayfix::map::MapError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// As [`from_csv_files`](Self::from_csv_files).
    pub fn from_csv(places: impl Read, roads: impl Read) -> Result<Self, MapError> {
        read(Builder::strict(), ("places", places), ("roads", roads)).map(|read| read.0)
    }

    /// Reads a map from two CSV files and drops, with a report, what [`cleaned`](Self::cleaned)
    /// drops. The format is that of [`from_csv_files`](Self::from_csv_files).
    ///
    /// Indices in the report count from 0, without headers and empty lines.
    ///
    /// # Errors
    ///
    /// As [`from_csv_files`](Self::from_csv_files), except for what is dropped.
    pub fn cleaned_from_csv_files(
        places: impl AsRef<Path>,
        roads: impl AsRef<Path>,
    ) -> Result<(Self, CleaningReport), MapError> {
        read_files(Builder::cleaning(), places.as_ref(), roads.as_ref())
    }

    /// Reads a map from two readers, as [`cleaned_from_csv_files`](Self::cleaned_from_csv_files);
    /// errors call them "places" and "roads".
    ///
    /// # Errors
    ///
    /// As [`cleaned_from_csv_files`](Self::cleaned_from_csv_files).
    pub fn cleaned_from_csv(
        places: impl Read,
        roads: impl Read,
    ) -> Result<(Self, CleaningReport), MapError> {
        read(Builder::cleaning(), ("places", places), ("roads", roads))
    }
}

fn read_files<P: Coordinates>(
    builder: Builder<P>,
    places: &Path,
    roads: &Path,
) -> Result<(RoadMap<P>, CleaningReport), MapError> {
    let (places, places_reader) = open(places)?;
    let (roads, roads_reader) = open(roads)?;
    read(builder, (&places, places_reader), (&roads, roads_reader))
}

fn read<P: Coordinates>(
    mut builder: Builder<P>,
    places: (&str, impl Read),
    roads: (&str, impl Read),
) -> Result<(RoadMap<P>, CleaningReport), MapError> {
    let [(first, _), (second, _)] = P::AXES;
    each_line(places, ["id", first, second, "name"], |line| {
        let (id, position) = (line.id(0)?, P::from_values([line.number(1)?, line.number(2)?]));
        builder
            .place(Place { id, position, name: line.text(3).to_owned() })
            .map_err(|error| error.to_string())
    })?;
    each_line(roads, ["from", "to", "class", "length_m"], |line| {
        let (from, to, class) = (line.id(0)?, line.id(1)?, line.text(2));
        let metres = match line.text(3) {
            "" if P::MAY_BE_STRAIGHT => None,
            _ => Some(line.number(3)?),
        };
        let class = excerpt(class).parse()?;
        match metres {
            Some(metres) => builder.road(Road { from, to, class, metres }),
            None => builder.straight(from, to, class),
        }
        .map_err(|error| error.to_string())
    })?;
    builder.build()
}

/// Calls `take` with each line after the header, which must name exactly these columns.
fn each_line(
    file: (&str, impl Read),
    columns: [&str; 4],
    mut take: impl FnMut(Row<'_>) -> Result<(), String>,
) -> Result<(), MapError> {
    let expected = columns.join(",");
    let find = |header: &StringRecord| {
        if *header == columns[..] {
            return Ok([Some(0), Some(1), Some(2), Some(3)]);
        }
        if header.is_empty() {
            return Err(format!("the file is empty, expected the header {expected:?}"));
        }
        // One column more than expected is enough to show that there are too many.
        let first: Vec<_> = header.iter().take(columns.len() + 1).map(excerpt).collect();
        let more = header.len() - first.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Err(format!("header {:?}{more}, expected {expected:?}", first.join(",")))
    };
    let take = |row: Row<'_>| match row.len() {
        4 => take(row),
        found => Err(format!("{found} columns, expected 4 ({expected})")),
    };
    each_row(file, Text::Strict, &columns, find, take)?;
    Ok(())
}

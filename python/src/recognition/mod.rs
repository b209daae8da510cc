//! Place recognition, from descriptors or similarities to answers, for `wayfix.recognition`.

mod answer;
mod beliefs;
mod labels;
mod mapper;
mod options;
mod queries;
mod recognizer;
mod recording;
mod source;
mod track;

pub(crate) use answer::PyAnswer;
pub(crate) use beliefs::PyPlaceBeliefs;
pub(crate) use labels::places;
pub(crate) use mapper::PyMapper;
pub(crate) use recognizer::PyRecognizer;
pub(crate) use recording::PyRecording;
pub(crate) use track::PyTrack;

//! Anything but a valid operator with inputs is refused.

use wayfix_learn::LogitTransition;

use crate::kit::refuses;

#[test]
fn what_is_no_logit_is_refused() {
    let logit = |field: &str, value: &str, expected: &str| {
        let fields = [
            ("states", "2"),
            ("inputs", "1"),
            ("to", "[0,1,0]"),
            ("from", "[0,0,1]"),
            ("intercept", "[0,0.5,-2]"),
            ("group", "[null,0,1]"),
            ("slopes", "[[0.5],[2.5]]"),
            ("ridge", "0.5"),
        ];
        let fields = fields.map(|(name, usual)| {
            format!("\"{name}\":{}", if name == field { value } else { usual })
        });
        let text = format!(r#"{{"version":1,{}}}"#, fields.join(","));
        if expected.is_empty() {
            serde_json::from_str::<LogitTransition>(&text).unwrap();
        } else {
            refuses::<LogitTransition>(&text, expected);
        }
    };
    logit("", "", "");
    logit("states", "0", "a transition operator needs at least one state, found none");
    let none = |state: usize| {
        format!(
            "column {state} (the transitions out of state {state}) has no weight above 0, expected at least one"
        )
    };
    logit("states", "4000000000000", &none(2));
    logit("from", "[1,1,1]", &none(0));
    logit("inputs", "2", "the number of slopes in a row is 1, expected the number of inputs");
    logit(
        "to",
        "[0,2,0]",
        "the transition from state 0 to state 2 is out of range, there are 2 states (0 to 1)",
    );
    logit("to", "[0,0,0]", "the transition from state 0 to state 0 is given twice");
    logit(
        "to",
        "[1,0,0]",
        "the state left by a move from state 0 to state 0 is 0, expected moves column by column, in ascending order",
    );
    logit("to", "[0,1]", "the number of values in `from` is 3, expected as many as in `to`");
    logit(
        "group",
        "[null,0,2]",
        "a number of slopes in `group` is 2, expected the number of one of the rows of `slopes`, from 0",
    );
    logit(
        "group",
        "[null,0,0]",
        "a row of `slopes` without a move is 1, expected a number in `group`",
    );
    logit(
        "intercept",
        "[0,1e301,0]",
        "the intercept of the move from state 0 to state 1 is 1e301, expected a value from -1e300 to 1e300",
    );
    logit("ridge", "-1", "the precision of the ridge is -1, expected a finite value of at least 0");
}

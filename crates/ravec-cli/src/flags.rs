//! Flags by the fields that they set.

use crate::arguments;
use std::collections::HashMap;

/// The flags of a command, by the names of their fields.
#[derive(Debug)]
pub struct Flags(HashMap<String, String>);

impl Flags {
    /// The flags of the command with this name, such as `mesh info`, and those of all commands.
    pub fn of(name: &str) -> Self {
        let program = arguments::command();
        let mut command = &program;
        let mut flags = HashMap::new();
        let mut add = |command: &clap::Command| {
            for argument in command.get_arguments() {
                let shown = match (argument.get_long(), argument.get_value_names()) {
                    (Some(long), _) => format!("--{long}"),
                    (None, Some([name, ..])) => name.to_string(),
                    (None, _) => continue,
                };
                flags.insert(argument.get_id().to_string(), shown);
            }
        };
        add(command);
        for word in name.split(' ') {
            let Some(found) = command.find_subcommand(word) else {
                break;
            };
            command = found;
            add(command);
        }
        Self(flags)
    }

    /// A sentence of the library, with flags in place of fields in backquotes. Other words in backquotes stay.
    pub fn name_in(&self, sentence: &str) -> String {
        let mut text = String::with_capacity(sentence.len());
        let mut parts = sentence.split('`');
        text.push_str(parts.next().unwrap_or_default());
        // every second part is between backquotes
        while let Some(quoted) = parts.next() {
            match (self.0.get(quoted), parts.next()) {
                (Some(flag), Some(rest)) => {
                    text.push_str(flag);
                    text.push_str(rest);
                }
                (None, Some(rest)) => {
                    text.extend(["`", quoted, "`", rest]);
                }
                (_, None) => {
                    text.push('`');
                    text.push_str(quoted);
                }
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_become_flags_and_other_quotes_stay() {
        let flags = Flags::of("retarget");
        for (sentence, shown) in [
            (
                "`grid` is 1, but must be 2 to 400",
                "--grid is 1, but must be 2 to 400",
            ),
            (
                "`sizes` is missing: `max_pixels`",
                "--size is missing: --max-pixels",
            ),
            (
                "see `ravec mesh check`, `grid",
                "see `ravec mesh check`, `grid",
            ),
            ("nothing", "nothing"),
            ("", ""),
        ] {
            assert_eq!(flags.name_in(sentence), shown);
        }
        assert_eq!(
            Flags::of("mesh simplify").name_in("`max_turn`"),
            "--max-turn"
        );
        assert_eq!(Flags::of("no such command").name_in("`grid`"), "`grid`");
    }
}

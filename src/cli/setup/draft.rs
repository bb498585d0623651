//! The text of a configuration: a shipped file, with its comments, in which values are replaced.

/// Lines of TOML in tables.
pub struct Draft(Vec<String>);

impl Draft {
    /// The shipped text without its first paragraph, which tells a person to fill it in.
    pub fn of(shipped: &str) -> Self {
        Self(shipped.lines().skip_while(|line| !line.is_empty()).skip(1).map(str::to_owned).collect())
    }

    /// Replaces the value of a key, or adds the key as the first of its table. `value` is TOML.
    pub fn set(&mut self, table: &str, key: &str, value: &str) {
        let is_header = |line: &String| line.trim_start().starts_with('[');
        let header = self
            .0
            .iter()
            .position(|line| line.trim_start().strip_prefix('[').and_then(|l| l.strip_prefix(table)).is_some_and(|l| l.starts_with(']')));
        let Some(header) = header else {
            return self.0.extend([String::new(), format!("[{table}]"), format!("{key} = {value}")]);
        };
        let end = self.0[header + 1..].iter().position(is_header).map_or(self.0.len(), |at| header + 1 + at);
        let of_key = |line: &String| line.split_once('=').is_some_and(|(name, _)| name.trim() == key);
        match self.0[header + 1..end].iter().position(of_key) {
            Some(at) => {
                let line = &mut self.0[header + 1 + at];
                let comment = comment(line).map(|comment| format!("   {comment}")).unwrap_or_default();
                *line = format!("{key} = {value}{comment}");
            }
            None => self.0.insert(header + 1, format!("{key} = {value}")),
        }
    }

    pub fn text(&self) -> String {
        self.0.join("\n") + "\n"
    }
}

/// The comment of a line, from its `#`.
fn comment(line: &str) -> Option<&str> {
    let mut quoted = false;
    line.char_indices().find_map(|(at, c)| {
        quoted ^= c == '"';
        (c == '#' && !quoted).then(|| &line[at..])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_replaced_in_its_own_table_and_its_comment_stays() {
        let mut draft = Draft::of("# fill in\n\n[a] # first\nkey = \"#1\"  # why\n[b]\nkey = 2");
        for (table, key, value) in [("b", "key", "3"), ("a", "key", "\"#4\""), ("b", "more", "5"), ("c", "new", "6")] {
            draft.set(table, key, value);
        }
        assert_eq!(draft.text(), "[a] # first\nkey = \"#4\"   # why\n[b]\nmore = 5\nkey = 3\n\n[c]\nnew = 6\n");
    }
}

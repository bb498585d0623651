//! The document: first the goals, then one section per part, with the plots beside it.

use anyhow::Context;
use std::path::{Path, PathBuf};

/// A number that carved must reach.
#[derive(Debug, Clone, PartialEq)]
pub struct Goal {
    /// The required value.
    pub asked: String,
    pub found: String,
    pub passed: bool,
}

impl Goal {
    pub fn new(asked: impl Into<String>, found: impl Into<String>, passed: bool) -> Self {
        Self { asked: asked.into(), found: found.into(), passed }
    }
}

#[derive(Debug, Clone)]
pub struct Plot {
    /// Name of the file without extension.
    pub name: &'static str,
    pub svg: String,
}

/// The contribution of a part.
#[derive(Debug, Clone, Default)]
pub struct Section {
    pub title: &'static str,
    pub text: String,
    pub goals: Vec<Goal>,
    pub plots: Vec<Plot>,
}

/// A Markdown table.
pub fn table(head: &[impl AsRef<str>], rows: &[Vec<String>]) -> String {
    let head: Vec<&str> = head.iter().map(AsRef::as_ref).collect();
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(head.len()));
    for row in rows {
        text += &format!("| {} |\n", row.join(" | "));
    }
    text + "\n"
}

/// Folder of the plots, beside the document.
const PLOTS: &str = "validation";

/// Writes document and plots into a folder. Returns the path of the document.
pub fn write(folder: &Path, head: &str, sections: &[Section]) -> anyhow::Result<PathBuf> {
    let plots = folder.join(PLOTS);
    std::fs::create_dir_all(&plots).with_context(|| format!("{}: cannot be made", plots.display()))?;
    let mut goals: Vec<Vec<String>> = sections
        .iter()
        .flat_map(|section| &section.goals)
        .map(|g| vec![g.asked.clone(), g.found.clone(), if g.passed { "pass" } else { "**missed**" }.to_owned()])
        .collect();
    // Sorted by goal number, whatever their part.
    goals.sort_by_key(|row| row[0].chars().next());
    let passed = sections.iter().flat_map(|s| &s.goals).filter(|g| g.passed).count();
    let mut text = format!("{head}## Goals\n\n{passed} of {} are met.\n\n{}", goals.len(), table(&["goal", "found", ""], &goals));
    for section in sections {
        text += &format!("## {}\n\n{}", section.title, section.text);
        for Plot { name, svg } in &section.plots {
            put(&plots.join(format!("{name}.svg")), svg)?;
            text += &format!("![{}]({PLOTS}/{name}.svg)\n\n", name.replace('_', " "));
        }
    }
    let path = folder.join("validation.md");
    put(&path, text.trim_end())?;
    Ok(path)
}

fn put(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, format!("{text}\n")).with_context(|| format!("{}: cannot be written", path.display()))
}

//! Reads settings from their sources: the command line with its variables, the file, the default.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::path::Path;

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::faults::Faults;
use super::value::Value;

/// One setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Setting {
    /// Its key in the file, with underscores; the flag has hyphens, the variable a prefix and capitals.
    pub(crate) key: &'static str,
    /// The default, as an operator would write it; empty: none.
    pub(crate) default: &'static str,
    /// What it does.
    pub(crate) help: &'static str,
    /// Whether the flag takes no value.
    pub(crate) is_switch: bool,
}

impl Setting {
    /// The name of its flag, without hyphens in front.
    pub(crate) fn flag(&self) -> String {
        self.key.replace('_', "-")
    }

    /// The name of its environment variable.
    pub(crate) fn variable(&self) -> String {
        format!("SLIPDRIVE_{}", self.key.to_uppercase())
    }

    fn argument(&self) -> Arg {
        let help = match self.default {
            "" => self.help.trim().to_owned(),
            default => format!("{} [default: {default}]", self.help.trim()),
        };
        let argument = Arg::new(self.key).long(self.flag()).env(self.variable()).help(help).action(ArgAction::Set);
        if self.is_switch {
            argument.num_args(0..=1).require_equals(true).default_missing_value("true").value_name("true|false")
        } else {
            argument.value_name(self.key.to_uppercase())
        }
    }
}

/// A struct of settings.
pub(crate) trait Settings: Sized {
    /// One entry per setting.
    const TABLE: &'static [Setting];

    /// Reads them all; one that cannot be read is added to the faults.
    fn read(reader: &mut Reader<'_>) -> Option<Self>;
}

/// The values that the command line and the environment give to some settings.
#[derive(Debug)]
pub(crate) struct Given<S> {
    values: BTreeMap<&'static str, Text>,
    settings: PhantomData<S>,
}

/// A value as it was written, and its source.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Text {
    text: String,
    source: Source,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    Flag,
    Variable,
    File,
    Default,
}

impl<S: Settings> Args for Given<S> {
    fn augment_args(command: Command) -> Command {
        // Settings of the whole program may stand before and after the subcommand.
        let is_global = command.get_name() == env!("CARGO_PKG_NAME");
        S::TABLE.iter().fold(command, |command, setting| command.arg(setting.argument().global(is_global)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<S: Settings> FromArgMatches for Given<S> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let value = |setting: &Setting| {
            let text = matches.get_one::<String>(setting.key)?.clone();
            let is_variable = matches.value_source(setting.key) == Some(ValueSource::EnvVariable);
            let source = if is_variable { Source::Variable } else { Source::Flag };
            Some((setting.key, Text { text, source }))
        };
        Ok(Self { values: S::TABLE.iter().filter_map(value).collect(), settings: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// The settings file, parsed; empty where there is none.
#[derive(Debug)]
pub(crate) struct Sources {
    file: toml::Table,
}

impl Sources {
    /// Reads the file, if there is one.
    pub(crate) fn new(path: Option<&Path>, faults: &mut Faults) -> Self {
        let Some(path) = path else { return Self { file: toml::Table::new() } };
        let read = std::fs::read_to_string(path).map_err(|error| format!("{} cannot be read: {error}", path.display()));
        let table = read.and_then(|text| text.parse().map_err(|error| format!("{}: {error}", path.display())));
        let file = table.unwrap_or_else(|fault| {
            faults.add(fault.trim().to_owned());
            toml::Table::new()
        });
        Self { file }
    }

    /// Adds a fault for each key of the file that is in no table.
    pub(crate) fn check_keys(&self, tables: &[&[Setting]], faults: &mut Faults) {
        for key in self.file.keys() {
            if !tables.iter().copied().flatten().any(|setting| setting.key == key) {
                faults.add(format!("`{key}` in the file is no setting"));
            }
        }
    }

    /// Reads all settings of a struct.
    pub(crate) fn read<S: Settings>(&self, given: &Given<S>, faults: &mut Faults) -> Option<S> {
        let texts = S::TABLE.iter().map(|setting| (setting.key, self.text(setting, &given.values, faults)));
        let texts = texts.collect();
        S::read(&mut Reader { table: S::TABLE, texts, faults })
    }

    /// The settings in force, with their sources.
    pub(crate) fn shown<S: Settings>(&self, given: &Given<S>) -> impl Iterator<Item = Shown> {
        S::TABLE.iter().map(|setting| {
            let text = self.text(setting, &given.values, &mut Faults::default());
            Shown { setting: *setting, text }
        })
    }

    /// The value of a setting as its first source gives it; an empty one is the default, such as that of a variable which a
    /// template leaves empty.
    fn text(&self, setting: &Setting, given: &BTreeMap<&'static str, Text>, faults: &mut Faults) -> Text {
        let text = given.get(setting.key).cloned().or_else(|| self.text_in_file(setting, faults));
        let default = || Text { text: setting.default.to_owned(), source: Source::Default };
        text.filter(|given| !given.text.is_empty()).unwrap_or_else(default)
    }

    fn text_in_file(&self, setting: &Setting, faults: &mut Faults) -> Option<Text> {
        let value = self.file.get(setting.key)?;
        let text = match value {
            toml::Value::String(text) => text.clone(),
            toml::Value::Integer(number) => number.to_string(),
            toml::Value::Float(number) => number.to_string(),
            toml::Value::Boolean(value) => value.to_string(),
            toml::Value::Datetime(_) | toml::Value::Array(_) | toml::Value::Table(_) => {
                faults.add(format!("`{}` in the file must be a string, a number or a boolean", setting.key));
                return None;
            }
        };
        Some(Text { text, source: Source::File })
    }
}

/// Reads the settings of one struct.
pub(crate) struct Reader<'a> {
    table: &'static [Setting],
    texts: BTreeMap<&'static str, Text>,
    faults: &'a mut Faults,
}

impl Reader<'_> {
    /// The value of a setting. Where its text breaks the rule that is a fault, and the value its default, so that the checks
    /// that follow find what else is wrong.
    pub(crate) fn read<T: Value>(&mut self, key: &'static str) -> Option<T> {
        let Text { text, source } = self.texts.get(key)?;
        if let Some(value) = T::parse(text) {
            return Some(value);
        }
        let setting = self.table.iter().find(|setting| setting.key == key)?;
        let place = place(setting, *source);
        self.faults.add(format!("`{key}` is \"{text}\" ({place}), must be {}", T::RULE));
        T::parse(setting.default)
    }
}

/// The source of a value, as faults and `--print-config` name it.
fn place(setting: &Setting, source: Source) -> String {
    match source {
        Source::Flag => format!("from --{}", setting.flag()),
        Source::Variable => format!("from {}", setting.variable()),
        Source::File => "from the file".to_owned(),
        Source::Default => "the default".to_owned(),
    }
}

/// One setting in force, as a line of TOML.
#[derive(Debug)]
pub(crate) struct Shown {
    setting: Setting,
    text: Text,
}

impl fmt::Display for Shown {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { setting, text: Text { text, source } } = self;
        let key = setting.key;
        if text.is_empty() {
            return writeln!(formatter, "# {key} is not set");
        }
        let is_value = text.parse::<f64>().is_ok_and(f64::is_finite) || text.parse::<bool>().is_ok();
        // Numbers such as `007` are none of TOML.
        let is_bare = is_value && format!("{key} = {text}").parse::<toml::Table>().is_ok();
        let value = if is_bare { text.clone() } else { toml::Value::from(text.as_str()).to_string() };
        writeln!(formatter, "{key} = {value} # {}", place(setting, *source))
    }
}

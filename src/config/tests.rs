//! Facts about the configuration.

use std::path::PathBuf;
use std::time::Duration;

use clap::CommandFactory as _;

use super::*;

fn arguments(flags: &[&str]) -> Arguments {
    Arguments::parse_from(["slipdrive", "serve"].iter().chain(flags))
}

fn config(flags: &[&str]) -> Result<ServerConfig, Faults> {
    let arguments = arguments(flags);
    let Command::Serve(serve) = &arguments.command else { panic!("serve was asked") };
    arguments.server_config(serve)
}

fn faults(flags: &[&str]) -> Vec<String> {
    config(flags).unwrap_err().0
}

/// A file with this text, removed on drop.
struct TemporaryFile(PathBuf);

impl TemporaryFile {
    fn new(name: &str, text: &str) -> Self {
        let path = env::temp_dir().join(format!("slipdrive-config-{}-{name}", std::process::id()));
        fs::write(&path, text).unwrap();
        Self(path)
    }

    fn path(&self) -> &str {
        self.0.to_str().unwrap()
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

#[test]
fn arguments_are_consistent() {
    Arguments::command().debug_assert();
}

#[test]
fn defaults_can_be_read() {
    let config = config(&[]).unwrap();
    assert_eq!((config.settings.queue_length, config.settings.admin), (64, None));
    assert_eq!(config.settings.queue_work_s, slipdrive::service::DEFAULT_QUEUE_WORK);
    assert_eq!((config.log.log.as_str(), config.log.log_format), ("info", LogFormat::Text));
}

#[test]
fn flags_set_the_service() {
    let config = config(&["--http", "127.0.0.1:0", "--workers", "3", "--queue-length", "4"]).unwrap();
    let settings = config.service_settings();
    assert_eq!((settings.workers.get(), settings.queue_length), (3, 4));
}

#[test]
fn flag_goes_before_file_and_file_before_default() {
    let file = TemporaryFile::new(
        "order",
        "queue_length = 7\nworkers = 2\ndrain_delay_s = 1.5\none_port = true\nlog = \"warn\"",
    );
    let config = config(&["--config", file.path(), "--workers", "5"]).unwrap();
    let settings = &config.settings;
    assert_eq!((settings.queue_length, settings.workers.unwrap().0.get()), (7, 5));
    assert_eq!((settings.drain_delay_s, settings.one_port), (Duration::from_millis(1500), true));
    assert_eq!((config.log.log.as_str(), settings.max_streams), ("warn", 128));
}

#[test]
fn empty_values_are_the_defaults() {
    let config = config(&["--config", "", "--log", "", "--max-streams", ""]).unwrap();
    assert_eq!((config.log.log.as_str(), config.settings.max_streams), ("info", 128));
    assert!(config.to_toml().contains("log = \"info\" # the default\n"), "{}", config.to_toml());
}

#[test]
fn all_faults_are_found_at_once() {
    let file =
        TemporaryFile::new("faults", "queue_size = 7\nmax_streams = 0\nlog_format = [\"json\"]\ngrpc = \"here\"");
    let found = faults(&["--config", file.path(), "--workers", "1000000", "--drain-delay-s=-1", "--log", "=="]);
    for expected in [
        "`queue_size` in the file is no setting",
        "`max_streams` is \"0\" (from the file), must be a whole number, at least 1",
        "`log_format` in the file must be a string",
        "`grpc` is \"here\" (from the file), must be an IP address with a port",
        "`workers` is \"1000000\" (from --workers), must be a whole number, at least 1, at most 4096",
        "`drain_delay_s` is \"-1\" (from --drain-delay-s), must be a number of seconds",
        "`log` is \"==\" (from --log), must be a log filter",
    ] {
        assert!(found.iter().any(|fault| fault.starts_with(expected)), "{expected} in {found:#?}");
    }
    assert_eq!(found.len(), 7, "{found:#?}");
    let found = faults(&["--workers", "0", "--http", "0.0.0.0:0", "--tls-key", "b"]);
    assert_eq!(found.len(), 3, "a value that cannot be read hides no other fault: {found:#?}");
}

#[test]
fn file_that_is_no_toml_is_found_with_its_line() {
    let file = TemporaryFile::new("syntax", "http = \n");
    let found = faults(&["--config", file.path()]);
    assert!(found[0].contains("line 1"), "{found:?}");
    assert!(faults(&["--config", "/nonexistent"])[0].contains("/nonexistent cannot be read"));
}

#[test]
fn settings_that_contradict_each_other_are_found() {
    let found = faults(&["--http", "127.0.0.1:9", "--grpc", "127.0.0.1:9", "--idle-timeout-s", "0"]);
    assert_eq!(found, ["`http` and `grpc` are both 127.0.0.1:9, must differ", "`idle_timeout_s` is 0, must be > 0 s"]);
    assert!(config(&["--http", "127.0.0.1:9", "--grpc", "127.0.0.1:9", "--one-port"]).is_ok());
    let found = faults(&["--max-connections", "16"]);
    assert!(found.len() == 1 && found[0].contains("`max_connections` is 16, must be > 16"), "{found:?}");
    assert!(config(&["--max-connections", "16", "--admin", "127.0.0.1:0"]).is_ok());
    let found = faults(&["--memory-budget-mib", "23"]);
    assert!(found.len() == 1 && found[0].contains("`memory_budget_mib` is 23, must be >= 24"), "{found:?}");
    assert!(config(&["--http", "127.0.0.1:0", "--admin", "127.0.0.1:0"]).is_ok(), "two free ports differ");
}

#[test]
fn every_setting_has_a_flag_and_a_variable() {
    let command = Arguments::command();
    let serve = command.find_subcommand("serve").unwrap();
    for setting in ServeSettings::TABLE {
        let argument = serve.get_arguments().find(|argument| argument.get_id() == setting.key).unwrap();
        assert_eq!(argument.get_long(), Some(setting.flag().as_str()));
        assert_eq!(argument.get_env().and_then(|name| name.to_str()), Some(setting.variable().as_str()));
    }
    for setting in LogSettings::TABLE {
        let argument = command.get_arguments().find(|argument| argument.get_id() == setting.key).unwrap();
        assert!(argument.is_global_set(), "{} stands before and after the command", setting.key);
    }
}

#[test]
fn public_server_without_keys_is_refused() {
    for flags in [["--http", "0.0.0.0:0"], ["--grpc", "[::]:0"], ["--http", "192.0.2.1:80"]] {
        let found = faults(&flags);
        assert!(found[0].contains(&flags[0][2..]) && found[0].contains("SLIPDRIVE_API_KEYS"), "{found:?}");
        assert!(config(&[flags[0], flags[1], "--allow-unauthenticated"]).is_ok());
    }
    assert!(config(&["--grpc", "0.0.0.0:0", "--one-port"]).is_ok(), "it is not bound");
    assert!(config(&["--admin", "0.0.0.0:0"]).is_ok(), "probes and metrics have no keys");
}

#[test]
fn configured_keys_that_are_none_are_refused() {
    let keys = |flags: &[&str], variable: Option<&str>| {
        let mut faults = Faults::default();
        let settings = config(flags).map_or_else(|faults| panic!("{faults}"), |config| config.settings);
        let keys = settings.keys(variable.map(OsString::from), &mut faults);
        faults.into_result(keys)
    };
    assert!(keys(&[], Some(" ,\n")).is_err());
    assert!(!keys(&[], Some("key")).unwrap().is_empty());
    assert!(keys(&[], None).unwrap().is_empty());
    #[cfg(unix)]
    {
        use std::os::unix::ffi::OsStringExt as _;
        let settings = config(&[]).map_or_else(|faults| panic!("{faults}"), |config| config.settings);
        assert!(settings.keys(Some(OsString::from_vec(b"fleet:k\xff".to_vec())), &mut Faults::default()).is_none());
    }
    let file = TemporaryFile::new("keys", "first\nsecond\n");
    assert!(keys(&["--api-keys-file", file.path()], Some("key")).is_err(), "one of both");
    assert!(faults(&["--api-keys-file", "/nonexistent"])[0].contains("cannot be read"));
}

#[test]
fn origins_are_whole_origins() {
    let given = config(&["--cors-origins", "https://a.example,http://b.example:8000"]).unwrap();
    assert_eq!(given.settings.cors_origins.0, ["https://a.example", "http://b.example:8000"]);
    let given =
        config(&["--cors-origins", "HTTPS://Fleet.Example:443,http://b.example:80,http://b.example:443"]).unwrap();
    let as_sent = ["https://fleet.example", "http://b.example", "http://b.example:443"];
    assert_eq!(given.settings.cors_origins.0, as_sent, "as browsers write them");
    for invalid in ["*", "a.example", "https://:443", "https://", "https://a.example/", "https://a b"] {
        assert!(faults(&["--cors-origins", invalid])[0].starts_with("`cors_origins`"), "{invalid}");
    }
}

#[test]
fn half_an_identity_is_refused() {
    assert!(faults(&["--tls-certificate", "a"])[0].contains("`tls_key` must be set"));
    assert!(faults(&["--tls-key", "b"])[0].contains("`tls_certificate` must be set"));
}

#[test]
fn unusable_identity_is_refused_and_never_ignored() {
    let found = faults(&["--tls-certificate", "/nonexistent/a", "--tls-key", "/nonexistent/b"]).join("\n");
    if cfg!(feature = "tls") {
        assert!(found.contains("/nonexistent/a") && found.contains("/nonexistent/b"), "all faults at once: {found}");
    } else {
        assert!(found.contains("built without TLS"), "{found}");
    }
}

#[test]
fn printed_configuration_is_one_that_can_be_read_and_has_no_secrets() {
    let keys = TemporaryFile::new("secret", "very-secret-key\n");
    let config_of = |flags: &[&str]| config(flags).unwrap();
    let first = config_of(&[
        "--api-keys-file",
        keys.path(),
        "--http",
        "0.0.0.0:1",
        "--workers",
        "2",
        "--one-port",
        "--max-streams",
        "007",
    ]);
    let printed = first.to_toml();
    assert!(printed.contains("workers = 2 # from --workers\n"), "{printed}");
    assert!(printed.contains("# admin is not set\n") && printed.contains("queue_length = 64 # the default\n"));
    assert!(printed.contains("# 1 API keys") && !printed.contains("very-secret-key"), "{printed}");
    let file = TemporaryFile::new("printed", &printed);
    assert_eq!(config_of(&["--config", file.path()]).settings, first.settings);
}

#[test]
fn documented_settings_are_those_of_the_code() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/operations.md");
    let document = fs::read_to_string(path).unwrap();
    let settings = ServeSettings::TABLE.iter().chain(LogSettings::TABLE);
    let rows: Vec<_> = settings
        .map(|setting| {
            let default = if setting.default.is_empty() { String::new() } else { format!("`{}`", setting.default) };
            let (flag, variable) = (setting.flag(), setting.variable());
            format!("| `--{flag}` | `{variable}` | {default} | {} |", setting.help.trim())
        })
        .collect();
    let documented: Vec<_> = document.lines().filter(|line| line.starts_with("| `--")).collect();
    assert_eq!(documented, rows, "the table of settings in {path}");
}

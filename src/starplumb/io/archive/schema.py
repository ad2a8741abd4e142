"""The tables of an archive: rows are only ever added, those of a campaign all at once."""

from __future__ import annotations

APPLICATION_ID = 0x53504C42
"""``SPLB``, by which ``file`` and we know such a database."""
EDITION = 1

TABLES = """
CREATE TABLE meta(key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE satellite(name TEXT PRIMARY KEY) STRICT;
CREATE TABLE instrument(
  satellite TEXT NOT NULL REFERENCES satellite(name), frame_from TEXT NOT NULL, frame_to TEXT NOT NULL,
  PRIMARY KEY(satellite, frame_from, frame_to)) STRICT;
CREATE TABLE campaign(
  id TEXT PRIMARY KEY,      -- SHA-256 of the digests of the inputs and of the options
  inputs TEXT NOT NULL,     -- SHA-256 of the digests of the inputs alone
  satellite TEXT NOT NULL, frame_from TEXT NOT NULL, frame_to TEXT NOT NULL,
  name TEXT NOT NULL, first_ns INTEGER NOT NULL, last_ns INTEGER NOT NULL, -- TAI since 2000-01-01T12:00:00 TAI
  added_utc TEXT NOT NULL, software TEXT NOT NULL, method TEXT NOT NULL, options_json TEXT NOT NULL,
  status TEXT NOT NULL CHECK(status IN ('ok', 'weak', 'refuted', 'singular', 'not_converged')),
  matrix BLOB NOT NULL, covariance BLOB, -- of the result, rad^2
  result_json BLOB NOT NULL, -- zlib
  FOREIGN KEY(satellite, frame_from, frame_to) REFERENCES instrument(satellite, frame_from, frame_to)) STRICT;
CREATE TABLE input(
  campaign TEXT NOT NULL REFERENCES campaign(id), name TEXT NOT NULL, sha256 TEXT NOT NULL,
  PRIMARY KEY(campaign, name)) STRICT;
CREATE TABLE image(
  campaign TEXT NOT NULL REFERENCES campaign(id), image_id TEXT NOT NULL, t_ns INTEGER NOT NULL,
  u_rad REAL, beta_rad REAL, temperatures_json TEXT, statistic REAL, observations INTEGER NOT NULL, sightings TEXT,
  PRIMARY KEY(campaign, image_id)) STRICT;
CREATE TABLE unknown(
  campaign TEXT NOT NULL REFERENCES campaign(id), name TEXT NOT NULL, unit TEXT NOT NULL,
  reference BLOB NOT NULL, expected BLOB NOT NULL, covariance BLOB, PRIMARY KEY(campaign, name)) STRICT;
CREATE TABLE normal(
  campaign TEXT NOT NULL REFERENCES campaign(id), image_id TEXT NOT NULL, names_json TEXT NOT NULL,
  information BLOB NOT NULL, vector BLOB NOT NULL, constant REAL NOT NULL, count INTEGER NOT NULL,
  PRIMARY KEY(campaign, image_id)) STRICT;
CREATE TABLE event(
  id TEXT PRIMARY KEY, satellite TEXT NOT NULL REFERENCES satellite(name), t_ns INTEGER NOT NULL,
  kind TEXT NOT NULL, note TEXT NOT NULL, added_utc TEXT NOT NULL) STRICT;
CREATE TABLE validity(
  id TEXT PRIMARY KEY, satellite TEXT NOT NULL, frame_from TEXT NOT NULL, frame_to TEXT NOT NULL,
  from_ns INTEGER NOT NULL, to_ns INTEGER, model_json TEXT NOT NULL, issued_utc TEXT NOT NULL,
  supersedes TEXT REFERENCES validity(id), reason TEXT NOT NULL,
  FOREIGN KEY(satellite, frame_from, frame_to) REFERENCES instrument(satellite, frame_from, frame_to)) STRICT;
CREATE TABLE withdrawn(
  campaign TEXT PRIMARY KEY REFERENCES campaign(id), at_utc TEXT NOT NULL, reason TEXT NOT NULL) STRICT;
CREATE INDEX campaign_by_inputs ON campaign(inputs);
CREATE INDEX campaign_by_instrument ON campaign(satellite, frame_from, frame_to);
CREATE INDEX image_by_time ON image(t_ns);
CREATE INDEX unknown_by_name ON unknown(name);
"""
NAMES = (
    *("satellite", "instrument", "campaign", "input", "image", "unknown"),
    *("normal", "event", "validity", "withdrawn"),
)
"""Tables in an order in which each refers only to those before it."""


def statements() -> str:
    """All that makes an empty archive."""
    kept = "".join(
        f"CREATE TRIGGER {table}_{what} BEFORE {what} ON {table} BEGIN "
        f"SELECT RAISE(ABORT, 'an archive only grows: withdraw with a reason'); END;\n"
        for table in ("meta", *NAMES)
        for what in ("UPDATE", "DELETE")
    )
    return f"{TABLES}{kept}PRAGMA application_id = {APPLICATION_ID};\nPRAGMA user_version = {EDITION};\n"

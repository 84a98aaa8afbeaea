"""The command line: one file per subcommand, which parses, calls and shows.

`main` finds the commands and turns errors into exit codes; `options` holds what all commands share;
`job` carries a run from its parsed options to its outcome; `results` turns nouns into JSON and `show`
into a screen. Nothing imports this room.
"""

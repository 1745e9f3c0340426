"""The files of clips: what they hold, their frames decoded and encoded, everything else kept; and motion files."""

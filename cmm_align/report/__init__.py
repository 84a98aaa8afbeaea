"""Pictures and summaries of what the stages found; the only room that knows matplotlib."""

"""Sky writing (RTC5): run-ins, run-outs and moved switch points."""

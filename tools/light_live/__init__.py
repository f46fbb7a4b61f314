"""corf's light tracer against Mitsuba 3, live."""

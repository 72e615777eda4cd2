"""Sources of streams: scheduled logs, a recorded session, a playback, a live log; knows no network."""

"""CDR, the bytes of one message: a general codec, templates of fixed layouts, rosbags' types; knows no container."""

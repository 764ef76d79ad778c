"""Whether a bench works: its devices, its synchronisation, drivers of other labs, this computer."""

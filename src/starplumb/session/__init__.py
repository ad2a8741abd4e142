"""The objects of the Python session: thin, over the plain data of the folders before.  They read, call, show and save;
what is computed is computed elsewhere.  The command line is written upon them."""

"""The Googol GUS controller: ranges, calls, lowering, listing text, C program, model, library."""

"""Listings to streams: `.gts` files, and the GT_ calls of C programs and of the vendor's manual."""

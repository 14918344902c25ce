"""Certificates of linear groups as polytopes: inclusions by weak duality."""

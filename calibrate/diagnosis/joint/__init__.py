"""All candidate effects of a sheet fitted at once, and those that BIC does not retain taken out."""

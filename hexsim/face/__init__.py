"""The public face: what `import hexsim as hx` gives. Thin: each function checks what it is given and calls one below."""

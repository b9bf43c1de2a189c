"""The equations of the report, one balance a file, each written once as a small compiled function.

`parameters` lays one leg's numbers out as a row; `valve`, `chamber`, `friction`, `supply` and `oil` hold the terms;
`leg` sums them into the balances of one leg; `effects` extends them. The plant integrates these functions and tracing
evaluates the same ones on measured signals. Nothing here imports MuJoCo.
"""

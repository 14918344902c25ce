"""Learned policies in files: reading them, asking them, and writing them as Soter or C.

Files of Stable-Baselines3 are read here without torch, pickles as data: nothing of a file is
imported or called.

In reading order:
- `policy_extern.py` makes a policy the step of an extern node; `policy_errors.py` says what is
  wrong with its file.
- `network.py`: the layers that files are read into, and what they answer in float32.
- `onnx_file.py` reads ONNX; `onnx_session.py` asks onnxruntime for the answer.
- `sb3_file.py` reads a policy of Stable-Baselines3, from the tensors, spaces and statistics that
  `sb3_parts.py` finds in pickles; `pickle_data.py` reads these.
- `soter_source.py` writes a network as Soter, with a bound of its error, `c_source.py` as C.
"""

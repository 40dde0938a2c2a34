"""Poses from images by a recurrent convolutional network, and their continuation: DeepVO with a
decoder.
"""
